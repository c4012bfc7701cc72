"""What motion a run has settled to."""
