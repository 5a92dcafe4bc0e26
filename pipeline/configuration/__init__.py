"""Loading of settings from presets and from overrides on the command line."""
