"""What stands in a report, one module a subject: functions that return a section, or None."""
