"""Everything about a picture that nobody gave: what is chosen, by what, and why."""
