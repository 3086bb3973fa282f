"""The shapes that hhsim ships as meshes, by formula: how they were made, and shapes for the tests."""
