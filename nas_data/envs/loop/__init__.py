"""What closes the loop between a task and what moves its arms; shared by every environment."""
