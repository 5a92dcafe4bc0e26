"""What `benchmarks/resilience.py` does to the product: flipped bytes, kills and hostile input."""
