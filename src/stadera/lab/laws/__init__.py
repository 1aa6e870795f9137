"""The paper's online laws (b) and (c), its mass of a robot at rest, and its routine of static poses, as baselines."""
