"""A flight for the eye: the still figure, the poster and the self-contained HTML report."""
