"""Reports of an excitation: of a leg, and of the trunk of a standing robot."""
