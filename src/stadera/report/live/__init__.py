"""Output for a running robot."""
