"""Logs of flights, from whatever a lab records. NED and FRD are nowhere else in this package."""
