/** Experiments that are ready to run, their progress, and their results. */

import { useQuery } from "@tanstack/react-query";
import { useLocation, useParams } from "wouter";
import { experimentKindsQuery, runsQuery } from "../../service/queries";
import page from "../Page.module.css";
import { ExperimentForm } from "./ExperimentForm";
import { ExperimentResult } from "./ExperimentResult";
import { ExperimentRuns } from "./ExperimentRuns";

export default function ExperimentsPage() {
  const { id } = useParams();
  const [, go] = useLocation();
  const kinds = useQuery(experimentKindsQuery);
  const first = kinds.data?.[0]?.name;
  const runs = useQuery({
    ...runsQuery({ kind: first ?? "", search: "", limit: 20, offset: 0 }),
    enabled: first !== undefined,
  });
  const selected = id === undefined ? runs.data?.runs[0]?.id : Number(id);
  return (
    <div className={page.page}>
      <h1 className={page.title}>Experiments</h1>
      <div className={page.columns}>
        <div className={page.column}>
          {kinds.error && <p className={page.empty}>{kinds.error.message}</p>}
          {kinds.data?.map((kind) => (
            <ExperimentForm
              key={kind.name}
              kind={kind}
              onStarted={(started) => go(`/experiments/${started}`)}
            />
          ))}
        </div>
        <div className={page.column}>
          {selected !== undefined && <ExperimentResult key={selected} id={selected} />}
          <ExperimentRuns runs={runs.data?.runs} selected={selected} />
        </div>
      </div>
    </div>
  );
}
