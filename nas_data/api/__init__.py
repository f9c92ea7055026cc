"""What notebooks and commands call: a function for each thing that `nas` does (`import nas_data as nas`)."""
