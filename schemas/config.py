"""The configuration: one frozen model per stage, which refuses unknown keys.

Unless a name says otherwise, lengths are in the normalised frame, where the object's diagonal is 1. So no setting
depends on the input's units or the object's size. Presets are in `pipeline/configuration/presets/`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Protocol, Self, TypeVar

from pydantic import AfterValidator, Field, model_validator

from schemas.joints import JointKind, JointType, joint_kind
from schemas.settings import DegreeRange, DifferentFrames, NamedUnit, Seed, Settings, SwappablePart, common

JOINT_SAMPLES = 60  # points of a part at which joints are judged
CONTACT = 2.0  # point spacings within which sampled surfaces touch
FEW_FRAMES = 6  # at most so many are taken for states in no order, of which all are tried as the canonical one
MOST_SAMPLED = 100_000_000  # points of a built sequence, all frames together: 2.4 GB
MOST_PIXELS = 10_000_000  # of the depth images of a frame: 1 GB while they are made


class _Sampled(Protocol):
    frames: int
    points: int


_SampledConfig = TypeVar("_SampledConfig", bound=_Sampled)


def _checked(config: _SampledConfig) -> _SampledConfig:
    if config.frames * config.points > MOST_SAMPLED:
        raise ValueError(f"expected at most {MOST_SAMPLED} points in all frames together")
    return config


class DepthConfig(Settings):
    """Pinhole depth cameras that look at the object."""

    cameras: int = Field(
        default=0, ge=0, le=100, description="depth cameras; 0: points are sampled, not seen as pixels"
    )
    width: int = Field(default=640, ge=8, le=2000, description="pixels in a row of an image")
    height: int = Field(default=480, ge=8, le=2000, description="rows of an image")
    field_of_view_degrees: float = Field(default=60.0, ge=1, le=150, description="horizontal field of view")
    distance: float = Field(
        default=1.5, ge=0.6, le=100, description="between a camera and the object's centre, in diagonals"
    )
    quantisation_percent: float = Field(
        default=0.1,
        ge=0,
        le=10,
        description="step of the depth at the object's distance, in % of the diagonal; steps grow with its square, as "
        "those of a disparity do; 0: none",
    )
    flying_share: float = Field(
        default=0.1, ge=0, le=1, description="share of the pixels at depth edges that show a point in the air behind"
    )
    grazing_degrees: float = Field(
        default=80.0, gt=0, le=90, description="a surface turned farther from the camera than this returns nothing"
    )

    @model_validator(mode="after")
    def _check_pixels(self) -> Self:
        if self.cameras * self.width * self.height > MOST_PIXELS:
            raise ValueError(f"expected at most {MOST_PIXELS} pixels in all images of a frame")
        return self


class ArtefactsConfig(Settings):
    """What else is wrong with scans, in each frame anew."""

    outlier_share: float = Field(
        default=0.0, ge=0, le=0.9, description="share of the points that lie anywhere in and around the object's box"
    )
    table_size: float = Field(
        default=0.0, ge=0, le=10, description="diameter in diagonals of a round piece of the table below; 0: none"
    )
    density_spread: float = Field(
        default=0.0, ge=0, le=3, description="standard deviation of the logarithm of the density; 0: an even one"
    )
    holes: int = Field(default=0, ge=0, le=1000, description="round patches without points")
    hole_radius: float = Field(default=0.06, gt=0, le=1, description="greatest radius of a hole, in diagonals")


class RoboartConfig(Settings):
    """How sequences are built from robot descriptions."""

    sequences_per_robot: int = Field(
        default=1, ge=1, le=1000, description="sequences of each robot, which move differently"
    )
    frames: int = Field(default=10, ge=2, le=10_000, description="frames of a sequence")
    points: int = Field(default=4096, ge=32, description="points per frame, sampled independently by area")
    novel_states: int = Field(default=3, ge=0, le=10_000, description="unseen states for the reanimation metric")
    sweep_degrees: DegreeRange = Field(
        default=(40.0, 90.0), description="least and greatest total motion of a joint over the sequence"
    )
    motion: Literal["sweep", "states"] = Field(
        default="sweep",
        description="joints move steadily, or stand in every frame at a state of its own, drawn over their whole range",
    )
    shuffled: bool = Field(default=False, description="the frames are in random order")
    min_part_share: float = Field(
        default=0.013, ge=0, lt=1, description="links with a smaller share of the surface join their parent"
    )
    noise_percent: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="standard deviation of the noise on each coordinate, in % of the diagonal; of depth cameras "
        "that of the depth at the object's distance, which grows with its square",
    )
    viewpoints: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="sample only what is visible from so many viewpoints; 0 samples the whole surface",
    )
    moving_viewpoints: bool = Field(
        default=False,
        description="viewpoints or depth cameras are placed anew for each frame, rather than standing still",
    )
    known_viewpoints: bool = Field(default=False, description="the sequence tells where they are")
    depth: DepthConfig = DepthConfig()
    artefacts: ArtefactsConfig = ArtefactsConfig()
    free_base: bool = Field(default=False, description="the base moves too, rather than standing still")
    coordinates: Literal["shared", "upright", "any"] = Field(
        default="shared",
        description="those of all frames, or each frame's own: upright ones turned by any angle about the vertical, "
        "tilted a little and shifted, any ones turned about any axis and shifted",
    )
    max_mesh_mib: float = Field(
        default=64.0, gt=0, le=65536, description="a mesh file that is larger, or unfolds to more, is refused"
    )

    @model_validator(mode="after")
    def _check_points(self) -> Self:
        return _checked(self)

    @model_validator(mode="after")
    def _check_sensor(self) -> Self:
        if self.viewpoints and self.depth.cameras:
            raise ValueError("expected either viewpoints or depth.cameras")
        return self


class HumansConfig(Settings):
    """How sequences of moving people are sampled."""

    frames: int = Field(default=14, ge=2, le=1000, description="frames of a sequence")
    frames_per_second: float = Field(default=10.0, gt=0, le=1000, description="frames a second")
    points: int = Field(default=4096, ge=32, description="points per frame, sampled independently by area")
    noise_percent: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="standard deviation of the noise on each coordinate, in % of the diagonal",
    )
    detail: Literal["fine", "coarse"] = Field(
        default="fine", description="16 parts, or 10 without belly, chest, hands and feet of their own"
    )

    @model_validator(mode="after")
    def _check_points(self) -> Self:
        return _checked(self)


class RegistrationConfig(Settings):
    """Which frames and how many points are used of registrations such as D-FAUST's.

    Registrations have the same surface points in every frame.
    """

    first: int = Field(default=0, ge=0, description="the first frame that is used, by its number in the file")
    frames: int = Field(default=17, ge=2, le=1000, description="frames that are used at most, from the first on")
    points: int = Field(default=4096, ge=32, description="points per frame, sampled independently")


class DepthImagesConfig(Settings):
    """How depth images become points, in metres."""

    units_per_metre: float = common(
        default=1000.0, gt=0, le=1e9, description="steps of whole-numbered depth images in a metre; TUM's have 5000"
    )
    stride: int = Field(default=1, ge=1, le=1000, description="only every so many-th row and column is used")
    farthest: float = Field(default=0.0, ge=0, description="pixels farther away, in metres, are left out; 0: none")


class MeshConfig(Settings):
    """How frames that are meshes become points."""

    take: Literal["surface", "vertices"] = Field(
        default="surface", description="of a mesh: points drawn from its surface by area, or its vertices"
    )
    points: int = common(
        default=20_000, ge=32, le=10_000_000, description="points that are drawn from the surface of each mesh"
    )
    max_mib: float = Field(default=256.0, gt=0, le=65536, description="a mesh file that is larger is refused")


def _box(corners: Corners) -> Corners:
    if not all(low < high for low, high in zip(corners[:3], corners[3:], strict=True)):
        raise ValueError("expected x, y and z of the least corner, then greater ones of the greatest")
    return corners


Corners = tuple[float, float, float, float, float, float]


class CleanConfig(Settings):
    """What is removed from every frame before all else. Everything is off by default."""

    box: Annotated[Corners, AfterValidator(_box)] | None = common(
        default=None,
        description="keep only what lies in a box: x, y, z of its least corner, then of its greatest, in input units",
    )
    plane: bool = common(
        default=False, description="remove the plane that the object stands on, and what lies beyond it"
    )
    plane_share: float = Field(
        default=0.05, gt=0, lt=1, description="such a plane holds at least this share of the points"
    )
    outliers: float = common(
        default=0.0,
        ge=0,
        le=100,
        description="remove points farther from their neighbours than the mean by so many standard deviations, "
        "for example 2; 0: none",
    )
    neighbours: int = Field(default=20, ge=1, le=1000, description="neighbours that outliers are judged by")
    specks: float = common(
        default=0.0,
        ge=0,
        lt=1,
        description="remove separate pieces with a smaller share of the points, for example 0.01; 0: none",
    )
    gap: float = Field(default=6.0, gt=0, description="pieces that are farther apart, in point spacings, are separate")


class IngestConfig(Settings):
    """The source of the frames and how they are read."""

    source: Literal["files", "roboart", "urdf", "humans", "dfaust"] = Field(
        default="files", description="where sequences come from; set by the data set"
    )
    units: NamedUnit = common(default="unknown", description="the unit of the input's coordinates")
    every: int = common(default=1, ge=1, description="only every so many-th frame is used, from the first on")
    min_points: int = Field(default=32, ge=4, description="a frame with fewer points is refused")
    max_points: int = Field(
        default=50_000_000, ge=64, le=10**12, description="a sequence with more points in all is refused"
    )
    correspond: bool = common(
        default=False,
        description="point i of a file's frames is the same surface point in all: sample each anew, and measure by it",
    )
    viewpoint: tuple[float, float, float] | None = common(
        default=None, description="where a camera stood that saw all frames: x, y, z in the input's coordinates"
    )
    depth: DepthImagesConfig = DepthImagesConfig()
    mesh: MeshConfig = MeshConfig()
    clean: CleanConfig = CleanConfig()
    roboart: RoboartConfig = RoboartConfig()
    humans: HumansConfig = HumansConfig()
    registrations: RegistrationConfig = RegistrationConfig()


class AlignmentConfig(Settings):
    """How frames are brought into common coordinates."""

    own_frames: Literal["auto", "yes", "no"] = common(
        default="auto", description="whether each frame has coordinates of its own; auto finds it out"
    )
    points: int = Field(default=2048, ge=64, description="points of a frame that are registered")
    probe_points: int = Field(default=768, ge=64, description="points of a frame that tell whether that is needed")
    connected: float = Field(
        default=0.35, ge=0, le=1, description="frames that have a greater share in common share coordinates"
    )


class GeometricFlowConfig(Settings):
    """Estimator `geometric`: non-rigid alignment by a deformation graph, then mutual nearest neighbours."""

    points: int = Field(default=2048, ge=16, description="points per frame that the alignment works on")
    nodes: int = Field(default=400, ge=4, le=100_000, description="rigid nodes of the deformation graph")
    coarse_points: int = Field(default=1024, ge=16, description="points per frame while the best start is looked for")
    coarse_nodes: int = Field(
        default=80, ge=4, le=100_000, description="nodes while the best start is looked for, at most `nodes`"
    )
    neighbours: int = Field(default=4, ge=1, le=1000, description="nodes that move one point")
    stiffness: tuple[Annotated[float, Field(gt=0, le=1e6)], ...] = Field(
        default=(30.0, 10.0, 3.0, 1.0, 0.3),
        min_length=1,
        max_length=100,
        description="weight of rigidity, coarse to fine",
    )
    iterations: int = Field(default=6, ge=1, description="Gauss-Newton steps at each stiffness")
    max_distance: float = Field(default=2.0, gt=0, description="matches farther apart are dropped, in point spacings")


class NetworkFlowConfig(Settings):
    """The feature network of the estimators `network` and `hybrid` (A.1)."""

    weights: Path | None = Field(
        default=None, description="weights.safetensors as `reart train-flow` writes it; default: those that are shipped"
    )


class TrainFlowConfig(Settings):
    """Training data and schedule of the feature network, for `reart train-flow` (A.1)."""

    seed: Seed = Field(default=0, description="the same seed trains the same weights")
    robots: tuple[str, ...] = Field(
        default=("atlas", "baxter", "laikago", "iiwa"), description="training robots; unavailable ones are left out"
    )
    robot_share: float = Field(default=0.25, ge=0, le=1, description="share of pairs of robots; the rest is made up")
    points: int = Field(default=2048, ge=64, description="points that a cloud is sampled with")
    step_degrees: DegreeRange = Field(
        default=(4.0, 120.0), description="least and greatest motion of a joint between the clouds of a pair"
    )
    turn_degrees: float = Field(
        default=25.0, ge=0, le=360, description="most that one cloud of a pair is turned by itself"
    )
    steps: int = Field(default=5000, ge=1, description="training steps")
    batch: int = Field(default=4, ge=1, le=1000, description="pairs in one step; each is drawn anew and seen once")
    learning_rate: float = Field(default=2e-3, gt=0, description="the highest; it rises at first and falls to zero")
    weight_decay: float = Field(default=1e-2, ge=0, description="weight decay of AdamW")
    validation_robots: tuple[str, ...] = Field(
        default=("cassie", "nao", "panda", "spot"), description="robots measured on while training, never trained on"
    )
    validation_pairs: int = Field(default=32, ge=1, le=10_000, description="pairs in one measurement")
    validate_every: int = Field(default=250, ge=1, description="steps between two measurements and checkpoints")


class FlowConfig(Settings):
    """The flow stage (A.1)."""

    estimator: SwappablePart = common(
        default="hybrid",
        description="what finds the flow: hybrid, geometric, network, fpfh, none, or package.module:function",
    )
    geometric: GeometricFlowConfig = GeometricFlowConfig()
    network: NetworkFlowConfig = NetworkFlowConfig()


class EnergyConfig(Settings):
    """Weights and sampling of E_recons (Eq. 5, A.6)."""

    lambda_cd: float = Field(default=1.0, ge=0, description="weight of E_CD")
    lambda_emd: float = Field(default=0.3, ge=0, description="weight of E_EMD")
    lambda_flow: float = Field(default=1.0, ge=0, description="weight of E_flow")
    flow_neighbours: int = Field(default=3, ge=1, le=1000, description="neighbours of the flow's interpolation")
    emd_downsampling: int = Field(default=4, ge=1, description="E_EMD uses every so many points, farthest first")
    emd_every: int = Field(default=5, ge=1, description="iterations between two assignments of E_EMD")
    emd_start: float = Field(default=0.5, ge=0, le=1, description="share of the run after which E_EMD joins in")
    neighbours_every: int = Field(
        default=5, ge=1, description="iterations between two nearest-neighbour searches of E_CD"
    )


class ReportedEnergyConfig(EnergyConfig):
    """E_recons where it is reported, not minimised: all of its terms from the start."""

    emd_start: float = Field(default=0.0, ge=0, le=1, description="share of the run after which E_EMD joins in")


class GumbelConfig(Settings):
    """Solver `gumbel`: gradient descent on a segmentation field and free motions, as published (A.6)."""

    max_parts: int = Field(default=20, ge=1, le=1000, description="most parts that the field can distinguish")
    iterations: int = Field(default=600, ge=1, description="steps of gradient descent")
    points: int = Field(default=2048, ge=16, description="points per frame in one iteration")
    hidden: int = Field(default=128, ge=1, le=10_000, description="width of the segmentation field")
    learning_rate_labels: float = Field(default=1e-3, gt=0, description="learning rate of the segmentation field")
    learning_rate_motion: float = Field(default=1e-3, gt=0, description="learning rate of the motions")
    learning_rate_end: float = Field(
        default=0.05, gt=0, le=1, description="share of the rates left at the end (cosine)"
    )
    temperature_start: float = Field(default=5.0, gt=0, description="temperature of the Gumbel softmax at the start")
    temperature_end: float = Field(default=1.0, gt=0, description="temperature of the Gumbel softmax at the end")
    start: Literal["flow", "identity"] = Field(
        default="flow", description="start from clustered flow trajectories, or from still parts as published"
    )


class AlternatingConfig(Settings):
    """Solver `alternating`: rounds of registration, minimum cuts, merging and splitting."""

    points: int = Field(default=4096, ge=64, description="points per frame that the fit works on")
    start_parts: int = Field(
        default=30, ge=1, le=10_000, description="parts that the flow is clustered into at the start"
    )
    rounds: int = Field(default=5, ge=1, description="rounds of refining, relabelling, merging and splitting")
    closing_rounds: int = Field(default=2, ge=0, description="last rounds, in which nothing is split")
    part_price: float = Field(default=4.0, ge=0, description="a part must lower the points' costs by more")
    boundary_price: float = Field(default=1.0, ge=0, description="price of a surface edge between two parts")
    truncation: float = Field(default=9.0, gt=0, description="most that one point can cost in one frame")
    reach_first: float = Field(
        default=5.0, gt=0, description="robust reach of matches in the first round, in point spacings"
    )
    reach: float = Field(
        default=3.0, gt=0, description="robust reach in other rounds, and for merges and patches, in point spacings"
    )
    reach_last: float = Field(default=2.0, gt=0, description="robust reach at the end, in point spacings")
    attachment: float = Field(default=1.0, ge=0, description="weight of touching parts' agreement at their contact")
    contact: int = Field(default=4, ge=1, description="surface edges that two parts must share to be merged")
    merge_iterations: int = Field(default=4, ge=1, description="registration steps before a merge is judged")
    patches: int = Field(
        default=120, ge=1, le=100_000, description="patches of the surface that are tried as new parts"
    )
    patch_points: int = Field(default=40, ge=6, description="points of such a patch")
    patch_iterations: int = Field(default=6, ge=1, description="registration steps of such a patch")
    min_part_share: float = Field(default=0.008, ge=0, lt=1, description="smaller parts are absorbed")


class BodiesConfig(Settings):
    """Another start of the solver `alternating`, for frames far apart: bodies found one by one over all frames."""

    points: int = Field(default=2048, ge=64, description="points per frame that bodies are found on")
    few_frames: int = Field(
        default=FEW_FRAMES, ge=0, description="sequences of at most so many frames are always searched"
    )
    most_frames: int = Field(default=12, ge=0, description="those of more frames never are")
    far: float = Field(
        default=0.2, ge=0, description="those between are where points move farther from frame to frame, in diagonals"
    )


class RelaxedFitConfig(Settings):
    """The relaxed fit of one candidate canonical frame."""

    solver: SwappablePart = common(
        default="alternating", description="what finds the parts: alternating, gumbel, or package.module:function"
    )
    energy: EnergyConfig = EnergyConfig()
    gumbel: GumbelConfig = GumbelConfig()
    alternating: AlternatingConfig = AlternatingConfig()
    bodies: BodiesConfig = BodiesConfig()


class ProjectionConfig(Settings):
    """Projection to a kinematic tree (Eq. 11, A.2)."""

    joints: tuple[JointType, ...] = common(
        default=("revolute", "prismatic"),
        min_length=1,
        max_length=100,
        description="kinds of joints that a model may have; with spherical ones links are judged by E_3DOF",
    )

    lambda_spatial: float = Field(default=100.0, ge=0, description="weight of E_spatial")
    lambda_1dof: float = Field(default=1.0, ge=0, description="weight of E_1DOF")
    samples_per_part: int = Field(
        default=JOINT_SAMPLES, ge=1, le=100_000, description="farthest points at which E_1DOF is measured"
    )
    contact: float = Field(
        default=CONTACT, ge=0, description="parts as near as so many point spacings touch: no E_spatial"
    )
    root: Literal["still", "middle", "ground"] = common(
        default="still",
        description="the part that stands still, the one in the middle of the body, as suits people and animals, or "
        "the largest that reaches the ground (z is up), as in upright scans with coordinates of their own",
    )
    still: float = Field(
        default=2.0, ge=0, description="where every part moves more, in point spacings, the largest is the base"
    )

    @property
    def kinds(self) -> tuple[JointKind, ...]:
        """The kinds of joints that a model may have."""
        return tuple(map(joint_kind, dict.fromkeys(self.joints)))


class MergingConfig(Settings):
    """Merging of parts that move alike (A.3)."""

    threshold: float = Field(
        default=0.0, ge=0, description="touching parts whose motions differ by less (RMS, in point spacings) become one"
    )


class CanonicalFrameConfig(Settings):
    """Which frames are tried as the canonical one, and how one is chosen (A.5)."""

    candidates: Annotated[int, Field(ge=1, le=100)] | None = common(
        default=None,
        description="canonical frames that are tried, from the middle one on; where it is not given, all of up to "
        f"{FEW_FRAMES} frames, and two of more",
    )
    frames: DifferentFrames = common(
        default=(), max_length=100, description="these frames are tried instead, where given"
    )
    by: Literal["fit", "project"] = Field(
        default="fit", description="choose by what the final fit leaves, or by E_project + E_group as published"
    )
    fits: Annotated[int, Field(ge=1, le=100)] | None = Field(
        default=None,
        description="candidates with a relaxed fit of their own; the others get the first one's; where it is not "
        f"given, all of up to {FEW_FRAMES} frames, and one of more",
    )

    def tried(self, frame_count: int | None) -> int:
        """How many frames are tried, of so many; the count of frames is None where it is not known yet."""
        return len(self.frames) or self.candidates or _few(frame_count) or 2

    def fitted(self, frame_count: int | None) -> int:
        """How many of them have a relaxed fit of their own."""
        return self.fits or (self.tried(frame_count) if _few(frame_count) else 1)


def _few(frame_count: int | None) -> int:
    """The count of frames where it is known and small, else 0."""
    return frame_count if frame_count is not None and frame_count <= FEW_FRAMES else 0


class FinalFitConfig(Settings):
    """The final fit (A.4): joints by Levenberg-Marquardt, then labels, links and parts given the joints."""

    points: int = common(default=4096, ge=16, description="points per frame that the fit works on")
    reach: float = Field(default=2.0, gt=0, description="robust reach of matches, in point spacings")
    iterations: int = Field(default=8, ge=0, description="Levenberg-Marquardt trials after each change")
    last_iterations: int = Field(default=15, ge=0, description="Levenberg-Marquardt trials at the end")
    still_root: float = Field(
        default=0.5, ge=0, description="a root that moves less (RMS, in point spacings) is held still"
    )
    hidden_links: bool = Field(
        default=True,
        description="insert links that the motion needs although no point belongs to them; never where cameras "
        f"are known, or in up to {FEW_FRAMES} frames with coordinates of their own",
    )
    link_tolerance: float = Field(
        default=0.25,
        ge=0,
        description="what a joint may leave (RMS, in point spacings) before a link is inserted on trial",
    )
    link_explains: float = Field(
        default=0.6, ge=0, le=1, description="share of that which a joint and an inserted link may leave at most"
    )
    pair_directions: int = Field(
        default=6, ge=1, le=1000, description="directions of axes that the joints of an inserted link are started with"
    )
    joint_samples: int = Field(
        default=JOINT_SAMPLES, ge=1, le=100_000, description="farthest points of a part at which joints are judged"
    )
    contact: float = Field(default=CONTACT, ge=0, description="parts as near as so many point spacings touch")
    settled: float = Field(
        default=0.003, ge=0, le=1, description="labels have settled where a smaller share of them changes in a round"
    )
    link_price: float = common(default=60.0, ge=0, description="an inserted link must lower the points' costs by more")
    freedom_price: float = common(
        default=30.0,
        ge=0,
        description="a joint of a kind with more degrees of freedom must lower the points' costs by more for each",
    )
    relabel: bool = Field(default=True, description="improve labels and parts too, not only joints")
    rounds: int = Field(default=3, ge=1, description="most rounds of labels and joints in turn, at the end")
    fused_frames: int = Field(default=10, ge=1, description="frames whose points are labelled together")
    boundary_price: float = Field(default=2.0, ge=0, description="price of a surface edge between two parts")
    min_part_share: float = Field(
        default=0.008, ge=0, lt=1, description="a part holds at least this share of the points"
    )
    part_price: float = common(
        default=30.0, ge=0, description="a part that lowers the points' costs by less is joined to a neighbour; 0: none"
    )
    prune_iterations: int = Field(default=5, ge=0, description="Levenberg-Marquardt trials before that is judged")
    energy_points: int = Field(default=2048, ge=16, description="points per frame at which E_recons is reported")
    energy: ReportedEnergyConfig = ReportedEnergyConfig()


class EvaluationConfig(Settings):
    """Evaluation (A.9)."""

    reanimation_iterations: int = Field(
        default=200, ge=1, description="Levenberg-Marquardt steps of the reanimation metric"
    )
    told_points: int = Field(default=4096, ge=16, description="points per frame that are tested for being observable")


class ExportConfig(Settings):
    """The robot description: meshes, masses and limits, which a simulator needs beyond the fit."""

    metres_per_unit: float | None = common(
        default=None,
        ge=1e-9,
        le=1e9,
        description="metres in a unit of the input's coordinates; none: by the input's unit, where unknown one metre",
    )
    surface: Literal["closed", "hull"] = Field(
        default="closed", description="a part's visible mesh: what its points enclose, or their convex hull"
    )
    collision: Literal["hull", "coacd"] = Field(
        default="hull", description="a part's convex collision mesh, or several by the optional package coacd"
    )
    triangles: int = common(default=3000, ge=20, description="triangles of a part's visible mesh, about")
    reach: float = Field(
        default=4.0, gt=0, le=1e3, description="radius in point spacings of the ball rolled over a part"
    )
    farthest: float = Field(
        default=3.0, gt=0, le=1e3, description="points farther from the posed model, in point spacings, are left out"
    )
    density: float = common(default=1000.0, gt=0, le=1e9, description="density of all parts, in kg / m^3")
    limit_margin: float = Field(
        default=0.1, ge=0, description="limits lie beyond the observed range by this share of it, at each end"
    )
    effort: float = Field(default=100.0, gt=0, description="most of a joint: N m, or N of a prismatic one")
    velocity: float = Field(default=3.0, gt=0, description="most of a joint: radians / s, or metres / s")
    settling: float = Field(
        default=0.5, gt=0, description="seconds in which damping slows a joint's free motion to 1 / e"
    )


class PipelineConfig(Settings):
    """Everything that a run depends on, except its input files."""

    seed: Seed = common(default=0, description="the same seed and input give the same model")
    ingest: IngestConfig = IngestConfig()
    alignment: AlignmentConfig = AlignmentConfig()
    flow: FlowConfig = FlowConfig()
    relaxed_fit: RelaxedFitConfig = RelaxedFitConfig()
    projection: ProjectionConfig = ProjectionConfig()
    merging: MergingConfig = MergingConfig()
    canonical_frame: CanonicalFrameConfig = CanonicalFrameConfig()
    final_fit: FinalFitConfig = FinalFitConfig()
    export: ExportConfig = ExportConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
