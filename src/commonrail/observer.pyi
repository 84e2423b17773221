"""Virtual sensor: quantities of shots from a measured pressure."""

from commonrail.plugins.observer.compensation import compensate as compensate
from commonrail.plugins.observer.design import DesignRow as DesignRow
from commonrail.plugins.observer.design import observer_design as observer_design
from commonrail.plugins.observer.file import Compensated as Compensated
from commonrail.plugins.observer.file import Observation as Observation
from commonrail.plugins.observer.file import ObservedShot as ObservedShot
from commonrail.plugins.observer.run import observe as observe
from commonrail.plugins.observer.study import DriftState as DriftState
from commonrail.plugins.observer.study import InjectionTrain as InjectionTrain
from commonrail.plugins.observer.study import ObserverSettings as ObserverSettings
