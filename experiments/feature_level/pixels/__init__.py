"""The paper's tables at pixel level: every frame is rendered and goes through the whole perception."""
