"""Test suites: weighted cases from recordings, and a verdict on a driving function."""
