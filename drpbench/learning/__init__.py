"""Making a policy: demonstrations of the expert, and training on them."""

from .learner import Learner as Learner
from .loss import chunk_loss as chunk_loss
