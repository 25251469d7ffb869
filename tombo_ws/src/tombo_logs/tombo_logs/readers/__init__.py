"""Readers of flight logs. NED and FRD are used nowhere else in this package."""
