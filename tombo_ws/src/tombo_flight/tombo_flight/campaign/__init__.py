"""Many flights: campaigns, their statistics and plots."""
