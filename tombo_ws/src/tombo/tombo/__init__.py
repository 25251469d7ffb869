"""The Python interface of the suite."""
