"""A log made ready, and a model of columns solved on it. No results, no text."""
