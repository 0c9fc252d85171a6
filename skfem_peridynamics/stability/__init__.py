"""Where codes break: stiff and extreme cases, each with what must hold, judged by numbers."""
