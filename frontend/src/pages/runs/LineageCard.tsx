/** Back from a run to parameters, bank, identifications and their raw data, and forth to what came of it. */

import { useQuery } from "@tanstack/react-query";
import { Fragment } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Verdict } from "../../components/Verdict";
import { parametersQuery } from "../../service/comparedModels";
import { lineageQuery } from "../../service/queries";
import type { Lineage } from "../../wire/types";
import page from "../Page.module.css";
import { appliedRuns, digestOfParameters } from "./appliedRuns";
import { LineagePicture } from "./LineagePicture";

export function LineageCard({ run }: { run: number }) {
  const { data, error } = useQuery(lineageQuery(run));
  return (
    <Card title="Lineage">
      {data === undefined ? (
        <p className={page.empty}>{error?.message ?? "Loading …"}</p>
      ) : (
        <>
          <LineagePicture nodes={data.nodes} self={`run-${run}`} />
          <Origins lineage={data} />
        </>
      )}
    </Card>
  );
}

function Origins({ lineage }: { lineage: Lineage }) {
  const { parameters, parameters_as_now, software, bank, entries, banks_built, runs_with_them } = lineage;
  return (
    <dl className={page.facts}>
      <dt>Software</dt>
      <dd>Sinew {software}</dd>
      <dt>Parameters</dt>
      <dd>
        <Verdict good={parameters_as_now}>
          {parameters_as_now ? `${parameters}, as now` : `${parameters}, changed since`}
        </Verdict>
        <AppliedFrom lineage={lineage} />
      </dd>
      <dt>Gains</dt>
      <dd>
        {bank === null ? (
          "from geometry"
        ) : (
          <Link href={`/banks/${bank.id}`}>
            {bank.name} v{bank.version}
          </Link>
        )}
      </dd>
      {entries.map((entry) => (
        <Fragment key={entry.S_nominal}>
          <dt>Entry {entry.name}</dt>
          <dd>
            {entry.run === null ? "not from a run" : <RunLink run={entry.run}>identified in run</RunLink>}
          </dd>
        </Fragment>
      ))}
      {banks_built.length > 0 && (
        <>
          <dt>Banks built from it</dt>
          <dd className={page.actions}>
            {banks_built.map((one) => (
              <Link key={one.id} href={`/banks/${one.id}`}>
                {one.name} v{one.version}
              </Link>
            ))}
          </dd>
          <dt>Runs with these</dt>
          <dd className={page.actions}>
            {runs_with_them.length === 0 ? "none" : runs_with_them.map((id) => <RunLink key={id} run={id} />)}
          </dd>
        </>
      )}
    </dl>
  );
}

/** The identifications that the run's parameters have their values from. */
function AppliedFrom({ lineage }: { lineage: Lineage }) {
  const { data } = useQuery(parametersQuery(null));
  const runs = appliedRuns(data?.versions ?? [], digestOfParameters(lineage.nodes));
  if (runs.length === 0) return null;
  return (
    <span className={page.dim}>
      {" with values of "}
      {runs.map((id, index) => (
        <Fragment key={id}>
          {index > 0 && ", "}
          <RunLink run={id}>run</RunLink>
        </Fragment>
      ))}
    </span>
  );
}

function RunLink({ run, children = "Run" }: { run: number; children?: string }) {
  return (
    <Link href={`/runs/${run}`}>
      {children} {run}
    </Link>
  );
}
