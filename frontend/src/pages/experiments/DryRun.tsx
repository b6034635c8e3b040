import { CloseButton } from "@mantine/core";
import { useEffect, useMemo, useRef } from "react";
import { Charts } from "../../charts/Charts";
import { RecordedSource } from "../../charts/sources";
import { useViewport } from "../../charts/viewport";
import { Card } from "../../components/Card";
import { plantWord } from "../../components/Header";
import { Outcome, RunState } from "../../components/RunState";
import { LocalizedText } from "../../components/values";
import { duration } from "../../samples/format";
import { fillText } from "../../samples/texts";
import type { useDryRun } from "../../service/api/experiments";
import { useStandardPanels } from "../../theme/useLayouts";
import { excerptOf } from "../../wire/curves";
import type { DryRun, ExperimentKind } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { DryRunProgress } from "./DryRunProgress";
import { RunSummary } from "./ExperimentForm";
import { Figures } from "./ExperimentRuns";
import { TEXTS } from "./texts";

interface DryRunResultProps {
  readonly dryRun: ReturnType<typeof useDryRun>;
  readonly kinds: readonly ExperimentKind[];
  /** Name of the open form, which shows its own refusal; this card shows refusals of other forms. */
  readonly openForm: string | undefined;
}

/** Shows the result of a dry run. */
export function DryRunResult({ dryRun, kinds, openForm }: DryRunResultProps) {
  const { variables, error, isIdle } = dryRun;
  if (variables === undefined || isIdle || (error !== null && variables.name === openForm)) return null;
  return <ShownDryRun dryRun={dryRun} kinds={kinds} name={variables.name} />;
}

interface ShownProps extends Pick<DryRunResultProps, "dryRun" | "kinds"> {
  readonly name: string;
}

function ShownDryRun({ dryRun, kinds, name }: ShownProps) {
  const { data, error, reset } = dryRun;
  const card = useRef<HTMLDivElement>(null);
  // the button is in another column: scroll to the result
  useEffect(() => {
    if (data !== undefined || error !== null) card.current?.scrollIntoView?.({ block: "nearest" });
  }, [data, error]);
  const title = kinds.find((kind) => kind.name === name)?.title ?? name;
  return (
    <div ref={card}>
      <Card
        title={TEXTS.dryRun}
        aside={!dryRun.isPending && <CloseButton aria-label={TEXTS.closeDryRun} size="sm" onClick={reset} />}
      >
        {data !== undefined && <Played name={name} title={title} result={data} />}
        {error !== null && (
          <p className={pageStyles.empty}>
            {fillText(TEXTS.notSimulated, { experiment: title })} <LocalizedText text={error.message} />
          </p>
        )}
        {dryRun.isPending && (
          <>
            <p className={pageStyles.empty}>{fillText(TEXTS.simulating, { experiment: title })}</p>
            <DryRunProgress onCancel={dryRun.cancel} />
          </>
        )}
      </Card>
    </div>
  );
}

interface PlayedProps {
  readonly name: string;
  readonly title: string;
  readonly result: DryRun;
}

function Played({ name, title, result }: PlayedProps) {
  return (
    <div className={pageStyles.fields}>
      <span>
        {fillText(TEXTS.simulated, { experiment: title, duration: duration(result.duration_s) })}{" "}
        <RunState state={result.status} /> <LocalizedText text={result.message} />
      </span>
      <Outcome of={result} />
      <RunSummary name={name} settings={result.settings} />
      <Figures criteria={result.criteria} metrics={result.metrics} of={TEXTS.dryRunSource} />
      {result.samples && (
        <DryRunCurves samples={result.samples} duration_s={result.duration_s} name="sinew-dry-run" />
      )}
    </div>
  );
}

interface CurvesProps {
  readonly samples: NonNullable<DryRun["samples"]>;
  readonly duration_s: number;
  /** Name of saved images and files. */
  readonly name: string;
}

/** Shows curves with a new time axis for each duration: a zoom of a shorter one would hide the rest. */
export function DryRunCurves(props: CurvesProps) {
  return <CurvesOfOneLength key={props.duration_s} {...props} />;
}

function CurvesOfOneLength({ samples, duration_s, name }: CurvesProps) {
  const source = useMemo(() => {
    const recorded = new RecordedSource(duration_s);
    recorded.setOverview(excerptOf(samples));
    return recorded;
  }, [samples, duration_s]);
  const home = useMemo(() => ({ span_s: duration_s, end_s: duration_s }), [duration_s]);
  return (
    <div className={pageStyles.charts}>
      <Charts
        panels={useStandardPanels()}
        source={source}
        control={useViewport(home)}
        home={home}
        longest_s={duration_s}
        limits={NO_LIMITS}
        marks={NO_MARKS}
        stale={false}
        fixed
        origin={DRY_RUN}
        name={name}
      />
    </div>
  );
}

const DRY_RUN = { of: TEXTS.dryRunNotStored, plant: plantWord("simulator"), bank: "" };
const NO_LIMITS: readonly never[] = [];
const NO_MARKS: readonly never[] = [];

/** Lists the parts of a run that the experiment created from it does not repeat. */
export function LeftOut({ of }: { of: readonly string[] }) {
  if (of.length === 0) return null;
  return (
    <div className={pageStyles.dim}>
      {TEXTS.leftOutIntro}
      <ul aria-label={TEXTS.leftOut} style={{ margin: 0, paddingLeft: 20 }}>
        {of.map((text) => (
          <li key={text}>{text}</li>
        ))}
      </ul>
    </div>
  );
}
