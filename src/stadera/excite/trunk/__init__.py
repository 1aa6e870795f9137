"""The weighing routine: the motion of a standing robot's trunk that tells most of its payload."""
