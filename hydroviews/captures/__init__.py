"""Where captures come from: a catalogue of published ones, downloads, photographs, videos."""
