"""The leaderboard as pages that open from disk, or on any web server, without a network."""
