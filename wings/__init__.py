"""What a person can live without: rigs, cameras of photographs, the report.  core imports none."""
