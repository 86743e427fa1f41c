"""What the studies share: findings and verdicts, what is kept on disk, figures and pages."""
