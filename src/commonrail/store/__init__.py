"""What a study has done so far, kept so that it survives: journal, lock, copies of its inputs."""
