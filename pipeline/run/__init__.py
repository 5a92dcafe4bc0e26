"""A run: the Luigi tasks that lead from a request to artifacts, the engine process that runs them, and its events."""
