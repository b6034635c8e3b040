/** Short names for the shapes that the service's schema defines. */

import type { components } from "./api.gen";

type Schemas = components["schemas"];

export type State = Schemas["State"];
export type Mode = Schemas["Mode"];
export type Limits = Schemas["LimitsView"];
export type Tuning = Schemas["TuningView"];
export type TuningRequest = Schemas["TuningRequest"];
export type TuningPreview = Schemas["TuningPreview"];
export type MotorMargins = Schemas["MotorPreview"];
export type LoopPreview = Schemas["LoopPreview"];
export type References = Schemas["References"];
export type StopProof = Schemas["StopProof"];
export type Task = Schemas["TaskView"];
export type Session = Schemas["SessionView"];
export type Identification = Schemas["IdentificationView"];
export type IdentificationRequest =
  | Schemas["ActuatorRequest"]
  | Schemas["MotorRequest"]
  | Schemas["SpringRequest"];
export type IdentificationKind = Schemas["IdentificationKind"];
export type IdentificationCurves = Schemas["IdentificationCurves"];
export type ChannelCurves = Schemas["ChannelCurves"];
export type MotorCurves = Schemas["MotorCurves"];
export type SpringCurves = Schemas["SpringCurves"];
export type Correlation = Schemas["Correlation"];
export type Motor = Schemas["MotorView"];
export type Spring = Schemas["SpringView"];
export type SpringTable = Schemas["SpringTableView"];
export type Prediction = Schemas["Prediction"];
export type Model = Schemas["ModelView"];
export type Bank = Schemas["BankView"];
export type BankDetail = Schemas["BankDetail"];
export type BankDifference = Schemas["BankDifference"];
export type BankFile = Schemas["BankFile"];
export type ChannelFit = Schemas["ChannelFit"];
export type ChosenTuning = Schemas["ChosenTuning"];
export type LoopFigures = Schemas["LoopFigures"];
export type ExperimentKind = Schemas["ExperimentKind"];
export type Experiment = Schemas["ExperimentView"];
export type Setting = Schemas["SettingView"];
export type Run = Schemas["RunView"];
export type Study = Schemas["StudyView"];
export type StudyDetail = Schemas["StudyDetail"];
export type StudyFigure = Schemas["StudyFigure"];
export type StudyMap = Schemas["StudyMap"];
export type Problem = Schemas["Problem"];
export type LiveMessage = Schemas["LiveMessage"];
export type Layout = Schemas["LayoutMessage"];
export type Mark = Schemas["EventMessage"];
export type Preferences = Schemas["Preferences"];
export type SavedTuning = Schemas["SavedTuning"];
export type Trial = Schemas["TrialView"];
export type PrintedFormula = Schemas["PrintedFormula"];
export type Lineage = Schemas["Lineage"];
export type ChecklistStep = Schemas["ChecklistStep"];
export type LineageNode = Schemas["LineageNode"];
export type SearchWords = Schemas["SearchWords"];
export type RunComparison = Schemas["RunComparison"];
export type ComparedMetric = Schemas["ComparedMetric"];
export type MetricHistory = Schemas["MetricHistory"];
export type RunMark = Schemas["RunMark"];
export type DryRun = Schemas["DryRunView"];
export type Queue = Schemas["QueueView"];
export type Metric = Schemas["MeasuredMetric"];
export type Criterion = Schemas["Criterion"];
export type ChainLink = Schemas["ChainLinkView"];
export type PlantView = Schemas["PlantView"];
export type Injection = Schemas["Injection"];
export type SystemState = Schemas["SystemView"];
export type Recordings = Schemas["RecordingsView"];
export type BringUp = Schemas["BringUpView"];
export type BringUpStep = BringUp["steps"][number];
export type BringUpResult = NonNullable<BringUpStep["result"]>;
export type BringUpRunning = NonNullable<BringUpStep["running"]>;
