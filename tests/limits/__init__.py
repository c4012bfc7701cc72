"""What the event-driven engine must be the limit of: stiff springs, short time steps, closed forms."""
