"""Where a monitor tells what it sees, without a network: JSON lines, MCAP files and a command."""
