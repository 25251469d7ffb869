"""A second simulator of quadrotors, on numpy and scipy alone.

It flies the vehicles that `tombo diagnose` is judged on. Nothing in it comes from the model that
the diagnosis fits: the equations, their integration, controller, courses and sensors were written
for this purpose alone. Test of the structure: it imports no other package of the suite.
"""
