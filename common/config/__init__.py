"""Configuration of a pair of robots: strict models, one TOML file, errors that name the file and the key."""

from common.config.arms import ArmsConfig, Degrees
from common.config.can import (
    BATTERY_V_PER_COUNT,
    BusConfig,
    DriveConfig,
    FollowerCanConfig,
    HomingConfig,
    LeaderCanConfig,
)
from common.config.control import BaseConfig, CompensationConfig, ControllerConfig, LimitsConfig, RealtimeConfig
from common.config.docking import DockingConfig, SupervisorConfig, TaughtConfig
from common.config.leader import LeaderConfig
from common.config.loading import M, default_config_path, load_config, validate, with_overrides
from common.config.network import DEFAULT_NAMESPACE, CertificateName, GatewayConfig, NetworkAddress, NetworkConfig
from common.config.perception import (
    BrightnessConfig,
    CameraConfig,
    DisturbanceConfig,
    EstimatorConfig,
    LedCodeConfig,
    LedsConfig,
    LensConfig,
    Quadruple,
)
from common.config.recorder import RecorderConfig
from common.config.robots import Config
from common.config.section import Coordinate, NonNegative, Pair, Positive, Section, Xyz, replaced

__all__ = [
    "BATTERY_V_PER_COUNT",
    "DEFAULT_NAMESPACE",
    "ArmsConfig",
    "BaseConfig",
    "BrightnessConfig",
    "BusConfig",
    "CameraConfig",
    "CertificateName",
    "CompensationConfig",
    "Config",
    "ControllerConfig",
    "Coordinate",
    "Degrees",
    "DisturbanceConfig",
    "DockingConfig",
    "DriveConfig",
    "EstimatorConfig",
    "FollowerCanConfig",
    "GatewayConfig",
    "HomingConfig",
    "LeaderCanConfig",
    "LeaderConfig",
    "LedCodeConfig",
    "LedsConfig",
    "LensConfig",
    "LimitsConfig",
    "M",
    "NetworkAddress",
    "NetworkConfig",
    "NonNegative",
    "Pair",
    "Positive",
    "Quadruple",
    "RealtimeConfig",
    "RecorderConfig",
    "Section",
    "SupervisorConfig",
    "TaughtConfig",
    "Xyz",
    "default_config_path",
    "load_config",
    "replaced",
    "validate",
    "with_overrides",
]
