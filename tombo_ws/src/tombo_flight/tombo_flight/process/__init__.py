"""What any long command needs: worker processes, signals, folders of results."""
