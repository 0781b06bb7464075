"""Where frames come from: sources with their options, merged, and paced by a clock or by devices."""
