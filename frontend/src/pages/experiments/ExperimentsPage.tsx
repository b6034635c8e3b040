/** Page of experiments: setup, dry run, queue, start, progress and results. */

import { NativeSelect } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useLocation, useParams } from "wouter";
import { Card } from "../../components/Card";
import { duration } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { experimentKindsQuery, useDryRun } from "../../service/api/experiments";
import { runsQuery } from "../../service/api/runs";
import { isText, useDraft } from "../../service/forms/drafts";
import { RunningCard } from "../operate/RunningCard";
import page from "../Page.module.css";
import { DryRunResult } from "./DryRun";
import { ExperimentForm } from "./ExperimentForm";
import { ExperimentResult, ExperimentRuns } from "./ExperimentRuns";
import { OwnExperiments } from "./OwnExperiments";
import { QueueCard } from "./QueueCard";
import { TEXTS } from "./texts";

/** Kinds of runs without a form: only HTTP and the command line accept lists of segments. */
const DEPRECATED = ["sequence"];

export default function ExperimentsPage() {
  const { id, asRun } = useParams();
  const [, go] = useLocation();
  const chosen = useDraft("kind of experiment", "", isText);
  const dryRun = useDryRun();
  const kinds = useQuery(experimentKindsQuery);
  const offered = kinds.data?.map((kind) => kind.run_kind);
  const names = offered === undefined ? "" : [...new Set([...offered, ...DEPRECATED])].join(",");
  const runs = useQuery({
    ...runsQuery({ kind: names, search: "", limit: 20, offset: 0 }),
    enabled: names !== "",
  });
  const selected = id === undefined ? runs.data?.runs[0]?.id : Number(id);
  const kind = kinds.data?.find((one) => one.name === chosen.value) ?? kinds.data?.[0];
  return (
    <div className={page.page}>
      <h1 className={page.title}>{TEXTS.title}</h1>
      <RunningCard place="above" />
      <div className={page.columns} data-wide="true">
        <div className={page.column}>
          {kinds.error && <p className={page.empty}>{kinds.error.message}</p>}
          {kind && (
            <Card
              title={TEXTS.newExperiment}
              aside={
                <span className={page.dim}>
                  {fillText(TEXTS.defaultDuration, { duration: duration(kind.duration_s) })}
                </span>
              }
            >
              <NativeSelect
                aria-label={TEXTS.kindOfExperiment}
                mb={8}
                data={kinds.data?.map(({ name, title }) => ({ value: name, label: title })) ?? []}
                value={kind.name}
                onChange={(event) => {
                  chosen.set(event.currentTarget.value);
                  // a refusal belongs to the previous form
                  if (dryRun.isError) dryRun.reset();
                }}
              />
              <ExperimentForm
                key={kind.name}
                kind={kind}
                onStarted={(started) => go(`/experiments/${started}`)}
                dryRun={dryRun}
              />
            </Card>
          )}
          <QueueCard kinds={kinds.data ?? []} />
        </div>
        <div className={page.column}>
          <RunningCard place="beside" />
          <DryRunResult dryRun={dryRun} kinds={kinds.data ?? []} openForm={kind?.name} />
          {selected !== undefined && <ExperimentResult key={selected} id={selected} />}
          <ExperimentRuns runs={runs.data?.runs} selected={selected} />
        </div>
      </div>
      <OwnExperiments
        asRun={asRun === undefined ? null : Number(asRun)}
        kinds={kinds.data ?? []}
        onRunOpened={() => go("/experiments", { replace: true })}
        onSaved={chosen.set}
      />
    </div>
  );
}
