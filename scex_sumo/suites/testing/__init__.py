"""Test of a driving function on a suite: futures, verdicts, number, files for continuous integration."""
