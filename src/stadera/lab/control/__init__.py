"""Controllers with which the test-bed's robots stand and walk."""
