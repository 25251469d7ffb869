"""The propeller workbench: any two-bladed propeller described, computed and drawn."""
