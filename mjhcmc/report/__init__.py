"""The report: one HTML file from a solution, to be looked at in any browser, without a network."""
