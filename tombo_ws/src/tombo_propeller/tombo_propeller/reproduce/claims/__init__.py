"""What the paper claims, checked one by one."""
