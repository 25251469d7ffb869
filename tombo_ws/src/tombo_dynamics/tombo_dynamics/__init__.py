"""The one model: rotations, the Tombo propeller, the rigid body and the registry of effects."""
