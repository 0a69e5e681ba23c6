"""Drives: from motor current to joint torque, one joint at a time."""
