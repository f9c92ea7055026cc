"""Physical effects that a model may lack: one file each, named after the effect."""
