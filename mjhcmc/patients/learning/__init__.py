"""Grading spasticity from what an examiner could measure: features, baselines, scores, and a search for leaks."""
