"""Alarms by the terms of ISA-18.2 / IEC 62682: rules, an engine without memory of its own, and what an alarm is."""
