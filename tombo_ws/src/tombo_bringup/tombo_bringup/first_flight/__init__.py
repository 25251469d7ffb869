"""The guided first flight of a real vehicle: its steps, their checks, and what runs them."""
