"""Files: OpenSim tables, motions read from them, and solutions as tables."""
