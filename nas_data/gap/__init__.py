"""Find where simulation and measurement disagree, name the missing effect, add it to the model, show the gap shrink."""
