"""What the studies share: findings and verdicts, finished steps on disk, figures and pages."""
