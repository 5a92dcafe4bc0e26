"""The mathematics that stages share. No input or output, no schemas."""
