"""What experiments share: runs spread over processes, and the files that they leave."""
