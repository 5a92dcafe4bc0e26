"""What each stage computes: one module or package a stage, pure functions on schema objects."""
