"""What acts below the set point after a blade strike: contact trigger, fold observer, loops."""
