/** Page of a flight record: charts and replay around a trip or trigger, which is t = 0 as in the export. */

import { useQuery } from "@tanstack/react-query";
import { useCallback, useMemo, useState } from "react";
import { Link, useParams } from "wouter";
import { Charts } from "../../charts/Charts";
import { RecordedSource, ShiftedSource } from "../../charts/sources";
import { Playhead, useViewport } from "../../charts/viewport";
import { Card } from "../../components/Card";
import { plantWord } from "../../components/Header";
import { LocalizedText } from "../../components/values";
import { useLive } from "../../live/react";
import { fixed, instant } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { flightSamplesQuery, flightsQuery, showFlightMoment } from "../../service/api/recordings";
import { runQuery } from "../../service/api/runs";
import { usePanels } from "../../theme/useLayouts";
import type { Columns } from "../../wire/curves";
import type { Flight } from "../../wire/types";
import { limitLines } from "../operate/LiveCharts";
import page from "../Page.module.css";
import { PlayedBack } from "./Replay";
import replay from "./Replay.module.css";
import { TEXTS } from "./texts";

const PERIOD_S = 0.001;

export default function FlightPage() {
  const id = Number(useParams().id);
  const flights = useQuery(flightsQuery);
  const samples = useQuery(flightSamplesQuery(id));
  const flight = flights.data?.find((one) => one.id === id);
  const missing = flights.data === undefined ? undefined : fillText(TEXTS.noFlightRecord, { flight: id });
  return (
    <div className={page.page}>
      <h1 className={page.title}>
        <Link href="/log">{TEXTS.log}</Link> / {fillText(TEXTS.flightRecord, { flight: id })}
      </h1>
      {flight === undefined ? (
        <p className={page.empty}>{samples.error?.message ?? missing ?? TEXTS.loading}</p>
      ) : (
        <Card title={flight.kind === "trip" ? TEXTS.trip : TEXTS.trigger}>
          <dl className={page.facts}>
            <dt>{TEXTS.time}</dt>
            <dd>{fillText(TEXTS.timeAndTick, { time: instant(flight.at), tick: flight.tick })}</dd>
            <dt>{TEXTS.event}</dt>
            <dd>
              <LocalizedText text={flight.text} />
            </dd>
            {flight.who !== "" && (
              <>
                <dt>{TEXTS.person}</dt>
                <dd>{flight.who}</dd>
              </>
            )}
            <dt>{TEXTS.range}</dt>
            <dd>
              {fillText(TEXTS.rangeAround, {
                before: fixed(flight.before_s, 3),
                after: fixed(flight.after_s, 3),
              })}
            </dd>
            <dt>{TEXTS.runColumn}</dt>
            <dd>
              {flight.run === null ? (
                TEXTS.noRun
              ) : (
                <Link href={`/runs/${flight.run}`}>{fillText(TEXTS.run, { run: flight.run })}</Link>
              )}
            </dd>
          </dl>
        </Card>
      )}
      {flight !== undefined && (
        <Card title={TEXTS.curves}>
          <div className={page.charts}>
            {samples.data === undefined ? (
              <p className={page.empty}>{samples.error?.message ?? TEXTS.loading}</p>
            ) : (
              <FlightCharts key={id} flight={flight} samples={samples.data} />
            )}
          </div>
        </Card>
      )}
    </div>
  );
}

function FlightCharts({ flight, samples }: { flight: Flight; samples: Columns }) {
  const { id, text, run, kind } = flight;
  const { data: recorded } = useQuery({ ...runQuery(run ?? 0), enabled: run !== null });
  const begin_s = samples.t?.[0] ?? 0;
  const end_s = (samples.t?.at(-1) ?? 0) + PERIOD_S;
  const home = useMemo(() => ({ span_s: end_s - begin_s, end_s }), [begin_s, end_s]);
  const control = useViewport(home);
  const source = useMemo(() => sourceOf(samples, begin_s, end_s), [samples, begin_s, end_s]);
  const [playhead] = useState(() => new Playhead(0));
  const panels = usePanels();
  const angles = useAngleUnit();
  const limits = useLive((live) => live.state?.limits);
  const read = useCallback((name: string, time_s: number) => source.at(name, time_s), [source]);
  const show = useCallback((time_s: number) => showFlightMoment(id, time_s), [id]);
  return (
    <div className={replay.withReplay}>
      <Charts
        panels={panels}
        source={source}
        control={control}
        home={home}
        longest_s={home.span_s}
        limits={useMemo(() => limitLines(limits, angles), [limits, angles])}
        marks={useMemo(() => [{ time_s: 0, text, fault: kind === "trip" }], [text, kind])}
        stale={false}
        playhead={playhead}
        origin={{
          of: fillText(TEXTS.replayOfFlight, { flight: id }),
          plant: recorded === undefined ? TEXTS.plantUnknown : plantWord(recorded.plant),
          bank: "",
        }}
        name={`sinew-flight-${id}`}
        remark={kind === "trip" ? TEXTS.timeFromTrip : TEXTS.timeFromTrigger}
      />
      <PlayedBack
        playhead={playhead}
        of={fillText(TEXTS.replayOfFlight, { flight: id })}
        read={read}
        show={show}
        begin_s={begin_s}
        end_s={end_s - PERIOD_S}
      />
    </div>
  );
}

function sourceOf(samples: Columns, begin_s: number, end_s: number): ShiftedSource {
  const source = new RecordedSource(end_s - begin_s);
  const signals = Object.entries(samples).map(([name, values]) => {
    const column = Float32Array.from(values);
    return [name, { minimum: column, maximum: column }] as const;
  });
  source.setOverview({
    raw: true,
    width_s: PERIOD_S,
    t: Float64Array.from(samples.t ?? [], (time_s) => time_s - begin_s),
    signals: Object.fromEntries(signals),
  });
  return new ShiftedSource(source, begin_s);
}
