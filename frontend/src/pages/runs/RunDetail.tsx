/** One run: what it came to and its curves first, then what it was and with which settings. */

import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Told } from "../../components/Told";
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
import { LineageCard } from "./LineageCard";
import { NoteCard } from "./NoteCard";
import { RunCharts } from "./RunCharts";
import { RunResult } from "./RunResult";
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
  return (
    <div className={page.page}>
      <h1 className={page.title}>
        <Link href="/runs">Runs</Link> / Run {id}
      </h1>
      {problem !== "" && (
        <p className={page.lead} role="alert">
          {capital(problem)}.
        </p>
      )}
      {data === undefined && <p className={page.empty}>{error?.message ?? "Loading …"}</p>}
      {data && (
        <>
          <RunResult run={data} />
          {others.length > 0 ? (
            <ComparedRuns run={data} others={others} compared={compared} />
          ) : (
            <Card title="Curves" aside={<CompareWith run={data} others={others} />}>
              <div className={page.charts}>
                <RunCharts run={id} at_s={at_s} />
              </div>
            </Card>
          )}
          <div className={page.halves}>
            <Facts run={data} />
            <NoteCard run={data} />
          </div>
          <SettingsCard settings={data.settings} />
          <LineageCard run={id} />
        </>
      )}
    </div>
  );
}

function Facts({ run }: { run: Run }) {
  return (
    <Card title={run.title}>
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
          {run.end_reason !== "" && <Told text={`: ${run.end_reason}`} />}
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
