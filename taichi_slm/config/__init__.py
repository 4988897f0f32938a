"""YAML -> one frozen, validated Config: the schema, units, reading, checking."""
