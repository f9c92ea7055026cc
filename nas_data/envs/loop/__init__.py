"""The control loop between a task and its simulator or robot, shared by all environments."""
