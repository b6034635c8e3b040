/** All runs, newest first, a page at a time; some of them may be chosen and set beside each other. */

import { Button } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { Link, useLocation } from "wouter";
import { Card } from "../../components/Card";
import { runsQuery } from "../../service/queries";
import page from "../Page.module.css";
import { addressOf, MOST_COMPARED } from "./address";
import { type Filters, NO_FILTERS, whereOf } from "./filters";
import { NoRuns } from "./NoRuns";
import { commonPlant, RunRows } from "./RunRows";
import { RunSearch } from "./RunSearch";

const PAGE = 50;

export function RunTable() {
  const [typed, setTyped] = useState("");
  const [filters, setFilters] = useState<Filters>(NO_FILTERS);
  const [offset, setOffset] = useState(0);
  const [chosen, setChosen] = useState<readonly number[]>([]);
  const [, go] = useLocation();
  const [asked] = useDebouncedValue(typed, 250);
  const form = whereOf(filters);
  const where = useMemo(() => [asked, form], [asked, form]);
  const runs = useQuery(runsQuery({ where, limit: PAGE, offset }));
  const total = runs.data?.total ?? 0;
  const rows = runs.data?.runs ?? [];
  const [first, ...others] = chosen;
  const plant = commonPlant(rows);

  return (
    <div className={page.page}>
      <h1 className={page.title}>Runs</h1>
      <Card
        title="Recorded runs"
        aside={
          <span className={page.actions}>
            {plant !== null && <span className={page.dim}>all on {plant}</span>}
            <Link href="/runs/metrics">Metrics over time</Link>
          </span>
        }
      >
        <RunSearch
          typed={typed}
          filters={filters}
          error={runs.error}
          onType={(text) => {
            setTyped(text);
            setOffset(0);
          }}
          onFilter={(changed) => {
            setFilters(changed);
            setOffset(0);
          }}
        />
        {runs.data === undefined && !runs.error && <p className={page.empty}>Loading …</p>}
        {runs.data !== undefined &&
          rows.length === 0 &&
          (asked === "" && form === "" ? <NoRuns /> : <p className={page.empty}>No run matches.</p>)}
        {rows.length > 0 && (
          <RunRows
            runs={rows}
            chosen={chosen}
            full={chosen.length >= MOST_COMPARED}
            onChoose={(id, is) => setChosen(is ? [...chosen, id] : chosen.filter((other) => other !== id))}
          />
        )}
      </Card>
      <div className={page.actions}>
        <Button
          variant="default"
          disabled={offset === 0}
          onClick={() => setOffset(Math.max(0, offset - PAGE))}
        >
          Newer
        </Button>
        <Button variant="default" disabled={offset + PAGE >= total} onClick={() => setOffset(offset + PAGE)}>
          Older
        </Button>
        <span className={page.dim}>
          {rows.length === 0 ? "none" : `${offset + 1} to ${offset + rows.length}`} of {total}
        </span>
        <Button
          variant="default"
          disabled={first === undefined || others.length === 0}
          onClick={() => first !== undefined && go(addressOf(first, others))}
        >
          Compare {chosen.length > 0 ? chosen.length : ""} chosen
        </Button>
        {chosen.length > 0 && (
          <Button variant="subtle" onClick={() => setChosen([])}>
            Choose none
          </Button>
        )}
      </div>
    </div>
  );
}
