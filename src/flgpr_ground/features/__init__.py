"""Features of alarms that rival stages compute."""
