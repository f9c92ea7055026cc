"""Analysis and editing of MuJoCo models: actuators, inertias, meshes, names, floating bases."""
