"""When and where: tasks, artifact store, presets and the command line. No numerics."""
