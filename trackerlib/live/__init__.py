"""What comes in over wires while it happens: ports, raw logs, lines, the SAIL host, session files."""
