"""Read and change model files for MuJoCo: actuators, inertias, meshes, names, floating bases."""
