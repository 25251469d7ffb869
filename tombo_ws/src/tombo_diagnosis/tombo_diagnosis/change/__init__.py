"""The change of a vehicle: new flights against its own healthy ones.

A vehicle file (`flight/vehicle_fit.py`) answers that only for logs with attitude and commands of
rotors. Here position and one drive channel, or set points, are enough.
"""
