"""Features of measured and simulated traces: delays, ramps, rates, quantities."""

from commonrail.plugins.features.injections import FeatureStatus as FeatureStatus
from commonrail.plugins.features.rate_trace import RateTrace as RateTrace
from commonrail.plugins.features.result import Features as Features
from commonrail.plugins.features.result import Injection as Injection
from commonrail.plugins.features.run import find_features as find_features
from commonrail.plugins.features.settings import FeatureSettings as FeatureSettings
from commonrail.plugins.features.shot_statistics import ShotStatistic as ShotStatistic
from commonrail.plugins.features.shot_statistics import shot_statistics as shot_statistics
from commonrail.plugins.features.targets import FeatureData as FeatureData
from commonrail.plugins.features.targets_file import FeatureTarget as FeatureTarget
