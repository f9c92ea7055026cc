"""Python API for notebooks and commands: one function per task of `nas` (`import nas_data as nas`)."""
