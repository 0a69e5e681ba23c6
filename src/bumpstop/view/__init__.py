"""The explorer: a scenario on a page in the browser, computed anew while a control moves."""
