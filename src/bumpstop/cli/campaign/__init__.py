"""``bumpstop campaign`` and its commands."""
