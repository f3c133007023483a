"""Files of a beacon hunt, in metres: survey logs, pings as CSV, sound-speed profiles as CSV."""
