/** What an experiment would give, as the simulator played it. */

import { CloseButton } from "@mantine/core";
import { useMemo } from "react";
import { Charts } from "../../charts/Charts";
import { RecordedSource } from "../../charts/recordedSource";
import { useViewport } from "../../charts/useViewport";
import { Card } from "../../components/Card";
import { Told } from "../../components/Told";
import { Outcome } from "../../components/Verdict";
import { duration } from "../../samples/format";
import { usePanels } from "../../theme/usePanels";
import { excerptOf } from "../../wire/curves";
import type { DryRun } from "../../wire/types";
import page from "../Page.module.css";
import { Figures } from "./Figures";
import { OrderWords } from "./OrderWords";

interface DryRunResultProps {
  /** Kind of experiment that was played. */
  readonly name: string;
  readonly result: DryRun;
  onClose(): void;
}

export function DryRunResult({ name, result, onClose }: DryRunResultProps) {
  return (
    <Card title="Dry run" aside={<CloseButton aria-label="Close dry run" size="sm" onClick={onClose} />}>
      <div className={page.fields}>
        <span>
          Simulated, nothing moved and nothing was stored: {result.status}, {duration(result.duration_s)}.{" "}
          <Told text={result.message} />
        </span>
        <Outcome of={result} />
        <OrderWords name={name} settings={result.settings} />
        <Figures criteria={result.criteria} metrics={result.metrics} of="dry run" />
        {result.samples && <Curves samples={result.samples} duration_s={result.duration_s} />}
      </div>
    </Card>
  );
}

interface CurvesProps {
  readonly samples: NonNullable<DryRun["samples"]>;
  readonly duration_s: number;
}

function Curves({ samples, duration_s }: CurvesProps) {
  const source = useMemo(() => {
    const recorded = new RecordedSource(duration_s);
    recorded.setOverview(excerptOf(samples));
    return recorded;
  }, [samples, duration_s]);
  const home = useMemo(() => ({ span_s: duration_s, end_s: duration_s }), [duration_s]);
  return (
    <div className={page.charts}>
      <Charts
        panels={usePanels()}
        source={source}
        control={useViewport(home)}
        home={home}
        longest_s={duration_s}
        limits={NO_LIMITS}
        marks={NO_MARKS}
        stale={false}
        name="sinew-dry-run"
      />
    </div>
  );
}

const NO_LIMITS = new Map();
const NO_MARKS: readonly never[] = [];
