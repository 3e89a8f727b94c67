"""Gymnasium environments of mecazen: `import mecazen_gym` registers `mecazen/Follow-v0`."""

import gymnasium

gymnasium.register(
    "mecazen/Follow-v0",
    entry_point="mecazen_gym.follow:FollowEnv",
    vector_entry_point="mecazen_gym.vector:FollowVectorEnv",
)
