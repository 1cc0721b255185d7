"""Requirements of tables and figures on a plan."""
