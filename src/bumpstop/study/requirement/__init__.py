"""Requirements: values of a parameter at which a scenario is still acceptable."""
