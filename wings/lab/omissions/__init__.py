"""The parts that a scene does not need, and the savings of leaving them out."""
