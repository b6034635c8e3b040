/** Page Log: events with time, person and their position in a recording. */

import { Button, NativeSelect, TextInput } from "@mantine/core";
import { useDebouncedValue } from "@mantine/hooks";
import { useInfiniteQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { TbSearch } from "react-icons/tb";
import { Card } from "../../components/Card";
import { fillText } from "../../samples/texts";
import { type LogAsked, logQuery } from "../../service/api/log";
import { useAngleUnit } from "../../service/api/preferences";
import page from "../Page.module.css";
import styles from "./Log.module.css";
import { CHOICES, kindsOf, LogRows, midnight } from "./LogRows";
import { TEXTS } from "./texts";

interface Filters {
  readonly words: string;
  readonly choice: string;
  readonly from: string;
  readonly to: string;
}

const NONE: Filters = { words: "", choice: "", from: "", to: "" };

export default function LogPage() {
  const [filters, setFilters] = useState<Filters>(NONE);
  const [asked] = useDebouncedValue(filters, 250);
  const angles = useAngleUnit();
  const log = useInfiniteQuery(
    logQuery(
      useMemo<LogAsked>(
        () => ({
          kinds: kindsOf(asked.choice),
          words: asked.words.trim(),
          since: midnight(asked.from),
          before: midnight(asked.to, 1),
          angles,
        }),
        [asked, angles],
      ),
    ),
  );
  const entries = log.data?.pages.flatMap((one) => one.entries) ?? [];
  const narrowed = Object.values(asked).some((value) => value !== "");
  return (
    <div className={page.page}>
      <h1 className={page.title}>{TEXTS.title}</h1>
      <Card title={TEXTS.entries}>
        <LogSearch filters={filters} onFilter={setFilters} />
        {log.error && <p role="alert">{log.error.message}</p>}
        {log.data === undefined && !log.error && <p className={page.empty}>{TEXTS.loading}</p>}
        {log.data !== undefined && entries.length === 0 && (
          <p className={page.empty}>{narrowed ? TEXTS.noMatch : TEXTS.noEvents}</p>
        )}
        {entries.length > 0 && <LogRows entries={entries} />}
      </Card>
      <div className={page.actions}>
        <Button
          variant="default"
          disabled={!log.hasNextPage}
          loading={log.isFetchingNextPage}
          onClick={() => void log.fetchNextPage()}
        >
          {TEXTS.older}
        </Button>
        <span className={page.dim}>{shownOf(entries.length, log.data?.pages[0]?.total ?? 0)}</span>
      </div>
    </div>
  );
}

function shownOf(shown: number, total: number): string {
  if (shown === 0) return TEXTS.shownNone;
  return shown < total ? fillText(TEXTS.shownNewest, { shown, total }) : fillText(TEXTS.shownAll, { shown });
}

function LogSearch({ filters, onFilter }: { filters: Filters; onFilter: (filters: Filters) => void }) {
  const set = (part: Partial<Filters>) => onFilter({ ...filters, ...part });
  return (
    <search className={styles.filters} aria-label={TEXTS.filters}>
      <TextInput
        className={styles.box ?? ""}
        type="search"
        label={TEXTS.search}
        aria-label={TEXTS.searchLog}
        placeholder={TEXTS.searchHint}
        maxLength={400}
        leftSection={<TbSearch size={14} />}
        value={filters.words}
        onChange={(event) => set({ words: event.currentTarget.value })}
      />
      <NativeSelect
        label={TEXTS.show}
        data={CHOICES}
        value={filters.choice}
        onChange={(event) => set({ choice: event.currentTarget.value })}
      />
      <TextInput
        type="date"
        label={TEXTS.from}
        value={filters.from}
        onChange={(event) => set({ from: event.currentTarget.value })}
      />
      <TextInput
        type="date"
        label={TEXTS.to}
        value={filters.to}
        onChange={(event) => set({ to: event.currentTarget.value })}
      />
      <Button
        variant="default"
        disabled={Object.values(filters).every((value) => value === "")}
        onClick={() => onFilter(NONE)}
      >
        {TEXTS.clear}
      </Button>
    </search>
  );
}
