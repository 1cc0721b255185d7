"""From a configuration to a plan of jobs: models, fingerprints of code, resources."""
