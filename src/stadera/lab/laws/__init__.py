"""The paper's baselines: online laws (b) and (c), mass at rest, routine of static poses, random excitation of a leg."""
