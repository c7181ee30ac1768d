"""What is drawn: one list of primitives for every scene, and a painter each for figures, films, pages."""
