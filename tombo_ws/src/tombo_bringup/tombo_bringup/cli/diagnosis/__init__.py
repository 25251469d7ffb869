"""Commands about diagnosis: diagnose, benchmark."""
