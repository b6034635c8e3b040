/** One run: when, by whom and its curves first, then what it came to, what it was and with which settings. */

import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { LocalizedText } from "../../components/LocalizedText";
import { RunState, unevaluated } from "../../components/RunState";
import { Verdict } from "../../components/Verdict";
import { dateTime, duration, fixed } from "../../samples/format";
import { capital } from "../../samples/words";
import { runQuery } from "../../service/queries";
import type { Run } from "../../wire/types";
import page from "../Page.module.css";
import { experimentOf } from "./address";
import { ComparedRuns } from "./ComparedRuns";
import { CompareWith } from "./CompareWith";
import { type Compared, USUAL } from "./compared";
import { KeyFigure, RunVerdict } from "./KeyFigure";
import { LineageCard } from "./LineageCard";
import { NoteCard } from "./NoteCard";
import { RunCharts } from "./RunCharts";
import { RunResult } from "./RunResult";
import styles from "./Runs.module.css";
import { SettingsCard } from "./SettingsCard";
import { Tags } from "./Tags";

interface RunDetailProps {
  readonly id: number;
  /** The second of the recording to be shown first; its begin where left out. */
  readonly at_s?: number | null;
  readonly others: readonly number[];
  /** How it is compared with these. */
  readonly compared?: Compared;
  /** What of the address could not be followed. */
  readonly problem?: string;
}

export function RunDetail({ id, at_s = null, others, compared = USUAL, problem = "" }: RunDetailProps) {
  const { data, error } = useQuery(runQuery(id));
  const together = [id, ...others].map((number) => `run ${number}`);
  return (
    <div className={page.page}>
      <h1 className={page.title}>
        <Link href="/runs">Runs</Link> / {others.length > 0 ? capital(together.join(", ")) : `Run ${id}`}
        {data && others.length === 0 && `: ${data.title}`}
      </h1>
      {problem !== "" && (
        <p className={page.lead} role="alert">
          {capital(problem)}.
        </p>
      )}
      {data === undefined && <p className={page.empty}>{error?.message ?? "Loading …"}</p>}
      {data && (
        <>
          {others.length > 0 ? (
            <>
              {[id, ...others].slice(0, MOST_NAMED).map((number) => (
                <NamedRun key={number} id={number} />
              ))}
              <ComparedRuns run={data} others={others} compared={compared} />
            </>
          ) : (
            <>
              <Made run={data} />
              <Card title="Curves" aside={<CompareWith run={data} others={others} />}>
                <div className={page.charts}>
                  <RunCharts run={id} at_s={at_s} />
                </div>
              </Card>
            </>
          )}
          <div className={styles.below}>
            <RunResult run={data} />
            <div className={page.column}>
              <Facts run={data} />
              <NoteCard run={data} />
            </div>
          </div>
          <SettingsCard settings={data.settings} />
          <LineageCard run={id} />
        </>
      )}
    </div>
  );
}

/** Lines above the curves of a comparison: more of them would push the curves out of sight. */
const MOST_NAMED = 4;

/** One of several compared runs, by its kind. */
function NamedRun({ id }: { id: number }) {
  const { data } = useQuery(runQuery(id));
  return data === undefined ? null : <Made run={data} title={`Run ${id}: ${data.title}`} />;
}

/** When, by whom, on what, and what it came to: in a line below the title. */
function Made({ run, title }: { run: Run; title?: string }) {
  return (
    <p className={styles.made}>
      {title !== undefined && <Link href={`/runs/${run.id}`}>{title}</Link>}
      <span>{dateTime(run.started)}</span>
      <span>{run.who}</span>
      <span>{duration(run.duration_s)}</span>
      <span>
        {run.plant}, parameters {run.parameters}
      </span>
      <RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />
      {run.outcome !== null && <RunVerdict run={run} />}
      {run.headline !== null && <KeyFigure headline={run.headline} />}
    </p>
  );
}

function Facts({ run }: { run: Run }) {
  return (
    <Card title={`Run ${run.id}`}>
      <dl className={page.facts}>
        <dt>Started</dt>
        <dd>
          {dateTime(run.started)} by {run.who}
        </dd>
        <dt>Length</dt>
        <dd>
          {duration(run.duration_s)}, {run.samples} samples
        </dd>
        <dt>Plant</dt>
        <dd>
          {run.plant}, parameters {run.parameters}
        </dd>
        {run.origin !== "" && (
          <>
            <dt>Origin</dt>
            <dd>{run.origin}</dd>
          </>
        )}
        {run.station !== "" && (
          <>
            <dt>Station</dt>
            <dd>{run.station}</dd>
          </>
        )}
        <dt>References</dt>
        <dd>
          <Link href={experimentOf(run.id)}>Make an experiment of this</Link>
        </dd>
        <dt>Tags</dt>
        <dd>
          <Tags run={run} />
        </dd>
        <dt>Ended</dt>
        <dd>
          {run.ended === null ? "still running" : dateTime(run.ended)}
          {run.end_reason !== "" && <LocalizedText text={`: ${run.end_reason}`} />}
        </dd>
        <dt>Completeness</dt>
        <dd>
          {run.missing_samples === null ? (
            "missing samples not known: the service died while it recorded"
          ) : (
            <Verdict good={run.missing_samples === 0}>
              {run.missing_samples === 0
                ? "no sample missing"
                : `${fixed(run.missing_samples, 0)} samples missing`}
            </Verdict>
          )}
          {run.samples_deleted !== null &&
            `; the samples were deleted ${dateTime(run.samples_deleted)} to make room`}
        </dd>
      </dl>
    </Card>
  );
}
