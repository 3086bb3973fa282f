"""Result files: schema, writer and reader."""
