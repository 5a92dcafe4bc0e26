"""Where settings come from: presets and the command line's overrides."""
