// Puts the page together.

function navigation(sections) {
  return element('ul', {}, sections.map((section) => element('li', {},
    element('a', {href: '#' + section.id},
      section.querySelector('h2').textContent.split(',')[0]))));
}

function fillPage() {
  const data = readReportData();
  document.title = `${data.title}: reconstruction report`;
  document.getElementById('title').textContent = data.title;
  const sceneCard = data.models.length > 0 ? new SceneCard(data) : null;
  const sections = [
    worthALook(data),
    sceneCard && card('view', 'Points and cameras', sceneCard.body),
    missingSection(data),
    viewGraphSection(data),
    camerasSection(data),
    depthSection(data, sceneCard),
    residualSection(data),
    coverageSection(data),
    trackSection(data),
    imagesSection(data, sceneCard),
    stagesSection(data),
    optionsSection(data),
  ].filter(Boolean);
  addTo(document.getElementById('main'), [
    summarySection(data),
    element('div', {class: 'cards'}, sections),
  ]);
  document.getElementById('navigation').append(navigation(sections));
  if (!data.report) {
    document.getElementById('footer-note').textContent =
      'The model has no report.json of depth_global_mapper beside it: pairs, ' +
      'missing images, stages and options are not known.';
  }
  // The page is there before the 3D view, whose start may take a moment.
  requestAnimationFrame(() => setTimeout(() => {
    if (sceneCard) sceneCard.start();
    document.documentElement.setAttribute('data-ready', 'true');
  }));
  return {data, sceneCard};
}

const page = fillPage();
