"""The change of a vehicle: new flights against its own healthy ones.

Position and one drive channel, or set points, are enough. A vehicle file (`flight/vehicle_fit.py`)
needs attitude. Tried on the same flights of crazyswarm2, it named none of two changes of the
motors, and one of two unchanged pairs was unknown; the features here answer all four right.
"""
