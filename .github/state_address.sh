#!/bin/sh
# States the address of the repository, which no file of it names, in what is released: sh .github/state_address.sh URL
set -eu
address="$1"
cat >> pyproject.toml <<TOML

[project.urls]
Repository = "$address"
Documentation = "$address/tree/main/docs"
Issues = "$address/issues"
Changelog = "$address/blob/main/CHANGELOG.md"
TOML
echo "repository-code: \"$address\"" >> CITATION.cff
echo "  repository: $address" >> recipe/recipe.yaml
