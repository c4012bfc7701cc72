"""What motion a run has settled to, and whether it rests for good."""
