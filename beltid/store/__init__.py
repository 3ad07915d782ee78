"""The only room that knows files: schemas, recordings, artifacts."""
