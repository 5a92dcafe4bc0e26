"""A run: Luigi tasks from a request to artifacts, the engine process that runs them, and its events."""
