"""Loops on bare arrays. They check nothing: the stages that call them do."""
