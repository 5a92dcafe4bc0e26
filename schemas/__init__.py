"""The contracts: pydantic models of every artifact, of the result's files and of the configuration."""
