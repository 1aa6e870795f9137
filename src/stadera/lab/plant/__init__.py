"""The test-bed: a MuJoCo plant made from a `Robot`, independent of the models that estimators use."""
